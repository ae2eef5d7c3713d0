"""What a job hands back: outputs as they are asked for, their files, and the manifest."""
