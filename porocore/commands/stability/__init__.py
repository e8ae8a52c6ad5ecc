"""Map of where the cell of a study creases, touches itself and becomes unstable."""
