"""What a file is, where it came from and how good it is: the work behind `softprint inspect`.

file_head   what the first bytes and the metadata of a file say
kinds       which kind of file that is, those of other packages included (entry points `softprint.kinds`)
summary     what is said about a file, as text and as JSON
*_kind      one kind of file each
"""
