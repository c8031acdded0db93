"""From trained results to weights files (TZA), and golden vectors for the C core."""
import training  # noqa: F401  before numpy is imported: says how many threads it takes
