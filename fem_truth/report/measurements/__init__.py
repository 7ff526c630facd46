"""The numbers of a report: errors, iteration counts, quality of the data and training results."""
