"""How often calibrated gel parameters' intervals contain the truth, over drawn emulated gels."""
