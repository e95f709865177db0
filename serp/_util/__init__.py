"""What every other package uses: files, numbers, text, compiled code, and nothing of the domain."""
