"""A package, and so its folders below: fixtures of that scope end with the last test of theirs."""
