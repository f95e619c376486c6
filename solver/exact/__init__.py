"""Method "exact": closed forms and error-controlled quadrature between events."""
