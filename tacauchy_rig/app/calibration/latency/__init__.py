"""How late force and image are against the arm, from a press that sways."""
