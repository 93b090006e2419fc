"""The depth of one photo, by a plane sweep with the photo as reference."""
