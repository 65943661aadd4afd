"""Training the network: pictures drawn for it, and a spatial teacher. Not shipped with the extension."""
