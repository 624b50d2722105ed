"""The paper's rows on its own aircraft."""
