"""Registration measured on pairs with known truth."""
