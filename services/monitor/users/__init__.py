"""`fleetsight users`: manages a monitor's users, whether it runs or not."""
