"""The world model: associates what all robots see into objects, each once, with a stable id and a place in the map."""
