"""What every room needs: errors, texts, files, processes, entry points; nothing here knows vehicles."""
