"""What the tests of this folder share lies beside them."""
