"""The paper's numbers beside ours, each with its verdict."""
