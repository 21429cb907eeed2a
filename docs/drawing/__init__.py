"""What the pictures of the documentation share, and one module for each page that has some."""
