"""What every other room uses: files, numbers, text, compiled code, and nothing of the domain."""
