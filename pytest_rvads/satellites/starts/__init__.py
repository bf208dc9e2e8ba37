"""Critical starts: the starts between which a driver changes from waiting to going."""
