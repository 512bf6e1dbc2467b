"""Messages that publishers keep for late subscribers: numbered, fetched from caches and put in order."""
