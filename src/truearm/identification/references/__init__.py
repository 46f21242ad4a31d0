"""What is known of a tip: points, seats, distances, surfaces, orientations; frames of sessions, tips, states."""
