"""Run folders that somebody made to do harm, and what each command makes of them."""
