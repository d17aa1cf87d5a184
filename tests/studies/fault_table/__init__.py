"""Break everything that can break, and write down what happens."""
