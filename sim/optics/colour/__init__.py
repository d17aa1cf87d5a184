"""What colour a surface has in a tactile image: models and tables, whatever draws them."""
