import os

# before numpy loads: its threads gain nothing on small matrices, and jobs beside each other wait
# for each other's
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
