"""The ground floor: values and plane geometry, nothing but numpy."""
