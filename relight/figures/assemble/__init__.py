"""One mesh of all parts: what shows of skin and clothes, hair, hats and props."""
