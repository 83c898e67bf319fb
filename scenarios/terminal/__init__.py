"""What a command says to people: tables in the terminal."""
