"""Evidence in, judged numbers and plain sentences out."""
