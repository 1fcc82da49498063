"""A button that copies text in the browser. The text is escaped; it never becomes markup or script."""

from __future__ import annotations

import html

_SCRIPT = (
    "const t=this.dataset.text,b=this,done=()=>{b.textContent='Copied';"
    "setTimeout(()=>{b.textContent=b.dataset.label},1500)};"
    "if(navigator.clipboard){navigator.clipboard.writeText(t).then(done)}"
    "else{const a=document.createElement('textarea');a.value=t;document.body.append(a);a.select();"
    "document.execCommand('copy');a.remove();done()}"
)
_STYLE = (
    "display:block;width:calc(100% - 1em);margin:0.3em 0.5em;padding:0.35em;font:inherit;font-size:0.85em;"
    "cursor:pointer;border:1px solid #0072B2;border-radius:4px;background:transparent;color:inherit"
)


def copy_button(label: str, content: str) -> str:
    """HTML of a button that puts `content` on the clipboard."""
    return (
        f'<button style="{_STYLE}" data-label="{html.escape(label)}" '
        f'data-text="{html.escape(content)}" onclick="{html.escape(_SCRIPT)}">{html.escape(label)}</button>'
    )
