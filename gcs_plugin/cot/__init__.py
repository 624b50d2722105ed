"""Cursor on Target: what is on our map stands on everybody's in ATAK, WinTAK, iTAK and TAK servers."""
