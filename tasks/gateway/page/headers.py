"""What a browser is told to refuse: for Simyard's own pages, and for what strangers have put into a store."""

from collections.abc import Mapping

from tasks.gateway.page.render import style_digest

_ALWAYS = {
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Cross-Origin-Resource-Policy": "same-origin",
    "X-Robots-Tag": "noindex",
}
_STRANGERS = "sandbox allow-downloads; default-src 'none'; style-src 'unsafe-inline'; img-src data:"
_NOWHERE = "base-uri 'none'; frame-ancestors 'none'"


def own_headers(*, is_secure: bool) -> Mapping[str, str]:
    """Returns the headers of a page that Simyard makes: its own style, its own pictures, and nothing else.

    Args:
        is_secure: Whether the browser came by TLS, and shall always do so.
    """
    # With "no-referrer" a browser would send the form without its origin, which the form's answer looks at.
    policy = f"default-src 'none'; style-src '{style_digest()}'; img-src 'self' data:; form-action 'self'; {_NOWHERE}"
    return {
        **_ALWAYS,
        "Content-Security-Policy": policy,
        "Referrer-Policy": "same-origin",
        "Cross-Origin-Opener-Policy": "same-origin",
        "Permissions-Policy": "camera=(), geolocation=(), microphone=(), payment=(), usb=()",
        "Cache-Control": "no-store",
        **({"Strict-Transport-Security": "max-age=31536000"} if is_secure else {}),
    }


def strangers_headers(*, keep_s: int = 0, file_name: str = "") -> Mapping[str, str]:
    """Returns the headers of what lies in a store: a browser gives it no script, no session and no address.

    ``sandbox`` makes its origin one that nothing else has. There is no Cross-Origin-Opener-Policy: browsers show no
    page that has both.

    Args:
        keep_s: How long the browser may keep it.
        file_name: What it is saved as; empty for what is shown.
    """
    return {
        **_ALWAYS,
        "Content-Security-Policy": f"{_STRANGERS}; form-action 'none'; {_NOWHERE}",
        "Referrer-Policy": "no-referrer",
        "Cache-Control": f"private, max-age={keep_s}" if keep_s else "no-store",
        **({"Content-Disposition": f'attachment; filename="{file_name}"'} if file_name else {}),
    }
