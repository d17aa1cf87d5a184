"""A twin of a press that goes on: pressed to each new force or depth from where it stands."""
