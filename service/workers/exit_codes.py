"""Exit codes of the processes of tasks, for what leaves them no word to say."""

from __future__ import annotations

OUT_OF_MEMORY = 3
"""Exit code of a task that needed more memory than it may have."""

OUT_OF_FILES = 4
"""Exit code of a task that wanted more open files than it may have."""

DISK_FULL = 5
"""Exit code of a task that found no room for what it writes."""

NO_PROCESS = 71
"""Exit code of a task for which the system had no process (EX_OSERR)."""
