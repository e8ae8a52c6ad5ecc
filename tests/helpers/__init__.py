"""Made-up cells, bodies, studies and plugins that tests share."""
