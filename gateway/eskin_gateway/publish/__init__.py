"""What other MQTT clients see: plain JSON, presence, Home Assistant discovery."""
