"""The methods that the paper compares, one file for each, with the publication and the
table it follows."""
