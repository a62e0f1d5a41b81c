"""Base parameters: structure, closed forms, certificate, and the BaseModel that carries them."""
