"""Training toolkit of lull: from EXR files to weights. Run as `python -m training.<name>`."""
import os

# Before numpy is imported: the threads of its small matrix products spin while they wait for each
# other, which on a busy machine made trainings take up to six times as long.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
