"""The kind, origin and quality of a file: the implementation of `softprint inspect`.

file_head   the first bytes and the metadata of a file
kind        what a kind of file offers, and the known kinds, including those of other packages (entry points
            `softprint.kinds`)
summary     the summary of a file, as text and as JSON
kinds/      one module for each kind of file
"""
