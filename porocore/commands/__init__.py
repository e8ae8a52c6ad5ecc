"""The commands that come with porocore by the hook of plugins: studies upon studies; no other room imports them."""
