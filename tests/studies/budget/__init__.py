"""How often a predicted force's stated interval contains the truth, over drawn emulated worlds."""
