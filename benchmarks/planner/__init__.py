"""How long planned flights take, against plainer planners, over areas of a committed seed."""
