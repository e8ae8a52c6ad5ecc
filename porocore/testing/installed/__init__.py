"""Check of an installed plugin by the conformance kit, in a process of its own."""
