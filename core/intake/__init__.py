"""What a telephone or a camera gives: photographs of its own formats, videos and archives, made into photographs."""
