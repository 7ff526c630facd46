"""`softprint verify`: cases with known answers, and how near Softprint comes to them."""
