"""What stands on the table: rigid bodies, and the shapes that tasks ask about."""
