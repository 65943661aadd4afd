"""A study with people who have a colour vision deficiency: its page, its answers, and what they say."""
