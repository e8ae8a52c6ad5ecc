"""Made-up cells with exact responses, on which the checks are tried."""
