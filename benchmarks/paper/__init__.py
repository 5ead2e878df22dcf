"""The paper: six manoeuvres, eight parameters, no ground truth."""
