"""Programs of their own behind one command each; none imports another."""
