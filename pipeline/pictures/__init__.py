"""Pictures that are made of layers and lamps."""
