"""The samples that training reads: what each kind of correction needs of the truth files, and how they are split."""
