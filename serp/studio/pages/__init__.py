"""The pages of the studio, drawn with NiceGUI; what they show comes from `serp.studio.session`."""
