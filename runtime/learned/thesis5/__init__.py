"""The contact-centric displacement field of thesis chapter 5."""
