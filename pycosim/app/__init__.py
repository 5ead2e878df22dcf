"""A study in; the loop of comparing, diagnosing and adding effects, in a browser, out."""
