"""The registry of published weights: kept in a folder by the monitor, asked over the bus by workers and operators."""
