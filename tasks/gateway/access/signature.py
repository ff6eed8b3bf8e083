"""AWS Signature Version 4, checked: a request is signed once more with the secret of the key that it names.

A signature that was used for a change is remembered: whoever saw such a request cannot send it a second time.
"""

import hashlib
import hmac
import re
import time
from calendar import timegm
from collections import OrderedDict
from collections.abc import Mapping
from functools import lru_cache
from threading import Lock
from typing import NamedTuple
from urllib.parse import quote

from specs.errors import AccessRefused
from tasks.gateway.rest_json import HttpRequest

SKEW_S = 300
"""How far the clocks of client and gateway may differ."""
SERVICE = "robomaker"
_ALGORITHM = "AWS4-HMAC-SHA256"
_END = "aws4_request"
_STAMP = re.compile(r"[0-9]{8}T[0-9]{6}Z", re.ASCII)
_SIGNATURE = re.compile(r"[0-9a-f]{64}", re.ASCII)
_NEEDED = frozenset({"host", "x-amz-date"})
_ONCE = ("authorization", "host", "x-amz-date", "x-amz-content-sha256")
_NO_TIME = "x-amz-date is not a time such as 20260131T235959Z"
_NOT_SIGNED = "the request is not signed: simyard access export NAME prints what boto3 and the AWS CLI need for it"
_PARTS = frozenset({"Credential", "SignedHeaders", "Signature"})
_LIFETIME_S = 2 * SKEW_S
_MOST = 1 << 18
_SAME_SECOND_S = 2.0  # a second of the client, and one for the way here


class Claim(NamedTuple):
    """What a request says of its signature; nothing of it is proved yet.

    Attributes:
        key_id: The access key.
        scope: Day, region, service and end, joined by slashes.
        stamp: When it was signed, as the client's clock has it.
        names: The headers that are signed, sorted.
        signature: In hexadecimal digits.
    """

    key_id: str
    scope: str
    stamp: str
    names: tuple[str, ...]
    signature: str


# Source: "AWS Signature Version 4 for API requests", AWS Identity and Access Management User Guide. The standard
# library is enough, as botocore stays in tasks/storage; a test holds this module against botocore's own signer. Only
# the form in the header Authorization is taken: who has a presigned address needs no key, and addresses end up in
# logs.
def claim_of(request: HttpRequest, now_s: float) -> Claim:
    """Returns what the head of a request says of its signature; its body is not needed.

    Args:
        request: As it came.
        now_s: Seconds since 1970 by this machine's clock.

    Raises:
        AccessRefused: There is no signature, it is of another form, or of another time.
    """
    headers = _joined(request)
    said = _authorization(request, headers)
    key_id, _, scope = said["Credential"].partition("/")
    stamp, names = headers.get("x-amz-date", ""), tuple(said["SignedHeaders"].split(";"))
    _check_stamp(stamp, now_s)
    _check_scope(scope, stamp)
    _check_names(names, headers)
    if not _SIGNATURE.fullmatch(said["Signature"]):
        raise _incomplete("Signature is 64 hexadecimal digits in small letters")
    return Claim(key_id, scope, stamp, names, said["Signature"])


def check_signature(request: HttpRequest, claim: Claim, secret: str) -> None:
    """Passes if a secret signed all of a request: path, query, signed headers and body.

    Args:
        request: As it came.
        claim: What its head says.
        secret: Of the key that the claim names.

    Raises:
        AccessRefused: Something is not as it was signed.
    """
    headers = _joined(request)
    digest = hashlib.sha256(request.body).hexdigest()
    said = headers.get("x-amz-content-sha256", digest)
    if said != digest:
        raise _invalid(
            "x-amz-content-sha256 is not the SHA-256 of the body; unsigned and streamed bodies are not taken"
        )
    _check_path(request.raw_path)
    canonical = _canonical(request, headers, claim.names, digest)
    text = "\n".join((_ALGORITHM, claim.stamp, claim.scope, hashlib.sha256(canonical.encode()).hexdigest()))
    expected = hmac.new(_signing_key(secret, claim.scope), text.encode(), hashlib.sha256).hexdigest()
    if not hmac.compare_digest(expected.encode(), claim.signature.encode()):
        raise _invalid(
            "the signature is not that of this request: is the secret right, and was nothing changed on the way?"
        )


def unknown_key(key_id: str) -> AccessRefused:
    """Returns the refusal of a key that is not known, or not any more."""
    shown = key_id[:64] if key_id.isascii() and key_id.isprintable() else "?"
    return AccessRefused(
        "UnrecognizedClientException", f"no access key {shown!r} here: simyard access list shows the keys"
    )


def _authorization(request: HttpRequest, headers: Mapping[str, str]) -> Mapping[str, str]:
    for name in _ONCE:
        if sum(each == name for each, _ in request.headers) > 1:
            raise _incomplete(f"the header {name} comes more than once")
    if "x-amz-security-token" in headers:
        raise AccessRefused("UnrecognizedClientException", "session tokens are not known here: unset AWS_SESSION_TOKEN")
    text = headers.get("authorization", "")
    if not text:
        signed = "X-Amz-Signature=" in request.query
        why = "presigned addresses are not taken: sign in the header" if signed else _NOT_SIGNED
        raise AccessRefused("MissingAuthenticationTokenException", why)
    algorithm, _, rest = text.partition(" ")
    pairs = [(name, value) for name, _, value in (part.strip().partition("=") for part in rest.split(","))]
    said = dict(pairs)
    if algorithm != _ALGORITHM or said.keys() != _PARTS or len(pairs) != len(_PARTS):
        raise _incomplete(f"Authorization is not {_ALGORITHM} with Credential, SignedHeaders and Signature, each once")
    return said


def _check_stamp(stamp: str, now_s: float) -> None:
    if not _STAMP.fullmatch(stamp):
        raise _incomplete(_NO_TIME)
    try:
        signed_s = timegm(time.strptime(stamp, "%Y%m%dT%H%M%SZ"))
    except ValueError as exc:
        raise _incomplete(_NO_TIME) from exc
    if abs(now_s - signed_s) > SKEW_S:
        here = time.strftime("%Y%m%dT%H%M%SZ", time.gmtime(now_s))
        what = "expired" if signed_s < now_s else "not yet current"
        raise _invalid(f"signature {what}: {stamp} is more than {SKEW_S // 60} min from {here}; set the client's clock")


def _check_scope(scope: str, stamp: str) -> None:
    day, *rest = scope.split("/")
    if len(rest) != 3 or not rest[0] or rest[1:] != [SERVICE, _END] or day != stamp[:8]:
        raise _invalid(f"Credential is KEY/{stamp[:8]}/REGION/{SERVICE}/{_END}")


def _check_names(names: tuple[str, ...], headers: Mapping[str, str]) -> None:
    if list(names) != sorted({name.lower() for name in names}):
        raise _incomplete("SignedHeaders are sorted, in small letters, each once")
    needed = _NEEDED | {name for name in headers if name.startswith("x-amz-")}
    if unsigned := sorted(needed - {*names}):
        raise _invalid(f"not signed: {', '.join(unsigned)[:200]}")
    if absent := sorted({*names} - headers.keys()):
        raise _invalid(f"signed, and not there: {', '.join(absent)[:200]}")


def _check_path(raw: str) -> None:
    # A signer takes dots and doubled slashes out of a path; two paths with one signature would be a way around a route.
    if not raw.startswith("/") or any(part in {"", ".", ".."} for part in raw[1:].split("/")[:-1]):
        raise _invalid("a path has no empty part and no dots")
    if raw.rpartition("/")[2] in {".", ".."}:
        raise _invalid("a path has no empty part and no dots")


def _canonical(request: HttpRequest, headers: Mapping[str, str], names: tuple[str, ...], digest: str) -> str:
    # By name, then by value: sorted as whole texts "a1=" would come before "a=".
    pairs = sorted(part.partition("=")[::2] for part in request.query.split("&")) if request.query else []
    lines = (
        request.method,
        quote(request.raw_path, safe="/~"),  # encoded a second time: all services but S3 do so
        "&".join(f"{name}={value}" for name, value in pairs),
        *(f"{name}:{headers[name]}" for name in names),
        "",
        ";".join(names),
        digest,
    )
    return "\n".join(lines)


def _joined(request: HttpRequest) -> dict[str, str]:
    """Returns the headers, those of one name joined by commas, spaces folded."""
    found: dict[str, str] = {}
    for name, value in request.headers:
        folded = " ".join(value.split())
        found[name] = f"{found[name]},{folded}" if name in found else folded
    return found


@lru_cache(maxsize=256)
def _signing_key(secret: str, scope: str) -> bytes:
    key = f"AWS4{secret}".encode()
    for part in scope.split("/"):
        key = hmac.new(key, part.encode(), hashlib.sha256).digest()
    return key


def _invalid(why: str) -> AccessRefused:
    return AccessRefused("InvalidSignatureException", why)


def _incomplete(why: str) -> AccessRefused:
    return AccessRefused("IncompleteSignatureException", why, 400)


# A signature is good for as long as the clocks may differ, before and after. So long this process remembers it. SDKs
# sign each attempt anew, but nothing that they sign differs between two equal requests of one second: the id of an
# attempt is not signed. Such a second one may be a retry. It is told to come later, which SDKs do by themselves,
# signed anew.
class UsedSignatures:
    """The signatures of the last minutes; several threads may ask."""

    def __init__(self, most: int = _MOST) -> None:
        """Remembers nothing yet.

        Args:
            most: How many are remembered; one takes some 200 bytes.
        """
        self._most = most
        self._lock = Lock()
        self._used: OrderedDict[bytes, float] = OrderedDict()

    def use(self, signature: str, now_s: float) -> None:
        """Remembers a signature that was checked.

        Args:
            signature: In hexadecimal digits.
            now_s: Seconds by a clock that is never set back.

        Raises:
            AccessRefused: It was used before, or so many are remembered that this one could not be.
        """
        mark = bytes.fromhex(signature)
        with self._lock:
            while self._used and now_s - next(iter(self._used.values())) > _LIFETIME_S:
                self._used.popitem(last=False)
            if mark in self._used:
                raise _sent_before(now_s - self._used[mark])
            if len(self._used) >= self._most:
                why = f"more than {self._most} changes in {_LIFETIME_S // 60} minutes; wait"
                raise AccessRefused("ThrottlingException", why, 400)
            self._used[mark] = now_s


def _sent_before(age_s: float) -> AccessRefused:
    """Returns the refusal of a signature that was used so many seconds ago."""
    why = "this request was sent before; sign it anew to send it again"
    if age_s < _SAME_SECOND_S:
        return AccessRefused("ThrottlingException", f"{why}, in another second", 400)
    return AccessRefused("InvalidSignatureException", why)
