"""The other end: programs that send pairs to a service, and keep them until it takes them."""
