"""What people start: the command, the studio and the tasks for other methods."""
