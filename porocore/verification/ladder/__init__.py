"""Cases with known solutions, from simple to complex, solved by every installed finite-element backend."""
