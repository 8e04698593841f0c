"""The dock "Photo map": photos or a video become a map in the open project."""
