"""How the pictures and files that ship with the project are made."""
