"""What the site makes of links to files of the repository that are no documents: their names."""

import posixpath
import re

LINK = re.compile(r"(?<!!)\[([^\]]+)\]\(([^)#\s]+)(#[^)]*)?\)")


def on_page_markdown(markdown, page, **_):
    """A link that leaves the folder of the documents becomes its text."""
    folder = posixpath.dirname(page.file.src_uri)

    def keep_or_name(match):
        text, target = match[1], match[2]
        is_outside = "://" not in target and posixpath.normpath(posixpath.join(folder, target)).startswith("..")
        return text if is_outside else match[0]

    return LINK.sub(keep_or_name, markdown)
