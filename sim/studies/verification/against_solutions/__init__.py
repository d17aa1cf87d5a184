"""The simulator against exact solutions, references and one real press."""
