"""The attitude of a stabilised camera as its gimbal reports it, and how the gimbal is pointed."""
