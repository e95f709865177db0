"""The pages of the studio, drawn with NiceGUI."""
