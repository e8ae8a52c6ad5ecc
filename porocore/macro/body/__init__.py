"""The body of the macroscale: its kinds, their meshes, and the named parts of their surface."""
