"""Made-up cells with exact responses, on which the laws are tried."""
