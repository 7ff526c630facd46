"""The kind, origin and quality of a file: the implementation of `softprint inspect`.

file_head   the first bytes and the metadata of a file
kinds       the known kinds of files, including those of other packages (entry points `softprint.kinds`)
summary     the summary of a file, as text and as JSON
*_kind      one kind of file each
"""
