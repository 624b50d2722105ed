"""The pilot process, the only thing that flies, and its rules, for any aircraft."""
