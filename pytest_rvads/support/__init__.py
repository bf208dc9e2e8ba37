"""What all other packages need: errors, texts, files, processes, entry points; no module here knows about vehicles."""
