"""`softprint verify`: cases with known solutions, and Softprint's errors in them."""
