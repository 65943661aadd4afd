"""Training the network that predicts scene networks, on pictures drawn for it. Not shipped with the extension."""
