import os

# before numpy loads: its matrices are small here, and threads that wait for a busy core made them
# 20 times slower
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
