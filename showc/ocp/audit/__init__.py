"""What a solution is worth between its nodes, without the program that made it."""
