"""Benchmarks: what things cost and how good they are, beside what people use today and what the machine allows."""
