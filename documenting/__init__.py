"""What makes the documentation from the code: ``docs/formats.md``, the JSON Schemas, and pictures of arm and viewer."""
