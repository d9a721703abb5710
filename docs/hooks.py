"""What the site makes of links to files of the repository that are no documents: links to the repository, where it is known."""

import os
import posixpath
import re

LINK = re.compile(r"(?<!!)\[([^\]]+)\]\(([^)#\s]+)(#[^)]*)?\)")


def repository():
    """The address of the repository's files, where the site is built by GitHub's workflows."""
    server, name = os.environ.get("GITHUB_SERVER_URL"), os.environ.get("GITHUB_REPOSITORY")
    return f"{server}/{name}/blob/HEAD" if server and name else None


def on_page_markdown(markdown, page, **_):
    """A link that leaves the folder of the documents leads to the repository, or becomes its text."""
    folder = posixpath.dirname(page.file.src_uri)
    files = repository()

    def outside_or_kept(match):
        text, target = match[1], match[2]
        path = posixpath.normpath(posixpath.join("docs", folder, target))
        if "://" in target or path.startswith("docs/"):
            return match[0]
        return f"[{text}]({files}/{path})" if files else text

    return LINK.sub(outside_or_kept, markdown)
