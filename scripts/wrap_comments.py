#!/usr/bin/env python3
"""Wraps comments of Rust sources at 110 columns, where rustfmt wraps the code (it does so for comments in nightly versions only).

    scripts/wrap_comments.py            wraps them
    scripts/wrap_comments.py --check    says which are too long, exit code 1 if any

Paragraphs with a line that is too long are filled anew, with lists' indentation; tables, code, headings, links' targets and drawings stay as they
are. Code in backticks and links are not broken where they fit in a line.
"""
import pathlib
import re
import subprocess
import sys

WIDTH = 110
COMMENT = re.compile(r"^(\s*)(//[/!]?)(?: (.*)|())$")
ITEM = re.compile(r"^(\s*)([*+-]|\d+[.)])\s+")
#: What a line must not begin with, since it would be read as something else.
OPENS = re.compile(r"^([*+>|#-]|\d+[.)]$|```|\[[^\]]*\]:)")
TOKEN = re.compile(r"(?:`[^`]*`|\[[^\[\]]*\](?:\([^()]*\)|\[[^\[\]]*\])?|\S)+")


def is_fixed(text):
    """Tables, headings, targets of links, code by indentation, drawings."""
    return bool(re.match(r"^(\||#|\[[^\]]*\]: |\s{4,}\S|<)", text) or re.search(r"\S {3,}\S", text))


def fill(words, first, rest, width):
    lines, line = [], first
    for k, word in enumerate(words):
        empty = line in (first, rest)
        if empty or len(line) + 1 + len(word) <= width:
            line = line + word if empty else f"{line} {word}"
            continue
        if OPENS.match(word):
            # The word before comes along.
            line, _, last = line.rpartition(" ")
            lines.append(line)
            line = f"{rest}{last} {word}"
        else:
            lines.append(line)
            line = rest + word
    return [*lines, line]


def wrapped(texts, width):
    """The lines of one comment, without its markers."""
    out, paragraph, fenced = [], [], False

    def flush():
        if paragraph:
            if any(len(text) > width for text in paragraph):
                item = ITEM.match(paragraph[0])
                first = item.group(0) if item else re.match(r"^\s*", paragraph[0]).group(0)
                words = TOKEN.findall(" ".join([paragraph[0][len(first):], *(text.strip() for text in paragraph[1:])]))
                out.extend(fill(words, first, " " * len(first), width))
            else:
                out.extend(paragraph)
            paragraph.clear()

    for text in texts:
        if text.lstrip().startswith("```"):
            flush()
            fenced = not fenced
            out.append(text)
        elif fenced or not text.strip() or (is_fixed(text) and not (paragraph and text.startswith("    ") and ITEM.match(paragraph[0]))):
            flush()
            out.append(text)
        else:
            if ITEM.match(text) or (paragraph and re.match(r"^\s*", text).end() < re.match(r"^\s*", paragraph[-1]).end()):
                flush()
            paragraph.append(text)
    flush()
    return out


def wrap(source):
    lines, out, k = source.split("\n"), [], 0
    while k < len(lines):
        match = COMMENT.match(lines[k])
        if not match:
            out.append(lines[k])
            k += 1
            continue
        head, texts = match.group(1, 2), []
        while k < len(lines) and (match := COMMENT.match(lines[k])) and match.group(1, 2) == head:
            texts.append(match.group(3) or "")
            k += 1
        before = "".join(head)
        out += [f"{before} {text}".rstrip() for text in wrapped(texts, WIDTH - len(before) - 1)]
    return "\n".join(out)


def main():
    check = "--check" in sys.argv[1:]
    listed = subprocess.run(["git", "ls-files", "*.rs"], capture_output=True, text=True, check=True).stdout.split()
    late = []
    for path in map(pathlib.Path, listed):
        source = path.read_text(encoding="utf-8")
        done = wrap(source)
        if done != source:
            late.append(path)
            if not check:
                path.write_text(done, encoding="utf-8")
    for path in late:
        print(path)
    sys.exit(1 if check and late else 0)


if __name__ == "__main__":
    main()
