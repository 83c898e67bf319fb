"""What no package offers: textbook and paper methods as a competent person writes them with NumPy and SciPy."""
