"""Message delivery: bounded mailboxes between threads and the event loop, reading, writing, shared memory."""
