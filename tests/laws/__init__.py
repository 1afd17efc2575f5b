"""Laws that users write: devices that have them, and what the library says with and without."""
