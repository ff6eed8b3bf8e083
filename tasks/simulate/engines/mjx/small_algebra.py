"""A function of small matrices, written out as sums of products.

XLA calls a library for each lane's matrix product, Cholesky factor and triangular solution, however small: of a base's
three by three numbers the calls take most of the time. Written out, all lanes are worked on at once, and a lane's sums
have one order whatever lanes are beside it.
"""

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
from jax.extend.core import ClosedJaxpr, Jaxpr, JaxprEqn, Literal

Result = TypeVar("Result")
# Larger factors are left to the library: written out they take long to compile.
_LARGEST = 10
_LONGEST_SUM = 8
_CALLS = {"jit": "jaxpr", "pjit": "jaxpr", "closed_call": "call_jaxpr", "custom_jvp_call": "call_jaxpr"}


def unroll_small_matrices(function: Callable[..., Result]) -> Callable[..., Result]:
    """Returns a function that gives the same as one of JAX, with its small matrices' algebra written out."""

    def call(*arguments: Any) -> Result:  # noqa: ANN401 - trees of arrays
        closed, form = jax.make_jaxpr(function, return_shape=True)(*arguments)
        arrays = _outputs(closed.jaxpr, closed.consts, jax.tree.leaves(arguments))
        return jax.tree.unflatten(jax.tree.structure(form), arrays)

    return call


def _outputs(jaxpr: Jaxpr, consts: Sequence[Any], arguments: Sequence[Any]) -> list[Any]:
    known: dict[Any, Any] = dict(zip([*jaxpr.constvars, *jaxpr.invars], [*consts, *arguments], strict=True))

    def read(variable: Any) -> Any:  # noqa: ANN401 - a variable's array
        return variable.val if isinstance(variable, Literal) else known[variable]

    for equation in jaxpr.eqns:
        found = _results(equation, [read(variable) for variable in equation.invars])
        known.update(zip(equation.outvars, found, strict=True))
    return [read(variable) for variable in jaxpr.outvars]


def _results(equation: JaxprEqn, given: list[Any]) -> Sequence[Any]:
    name, parameters = equation.primitive.name, equation.params
    if name in _CALLS:
        return _closed(parameters[_CALLS[name]], given)
    if name in _LOOPS:
        return _LOOPS[name](parameters, given)
    if name in _ALGEBRA and _is_small(name, given, parameters):
        return [_ALGEBRA[name](*given, parameters).astype(given[0].dtype)]
    found = equation.primitive.bind(*given, **parameters)
    return found if equation.primitive.multiple_results else [found]


def _closed(closed: ClosedJaxpr | Jaxpr, given: Sequence[Any]) -> list[Any]:
    if isinstance(closed, ClosedJaxpr):
        return _outputs(closed.jaxpr, closed.consts, given)
    return _outputs(closed, (), given)


def _is_small(name: str, given: list[Any], parameters: dict[str, Any]) -> bool:
    if name == "dot_general":
        return all(array.size for array in given)
    return given[0].shape[-1] <= _LARGEST and parameters.get("left_side", True)


def _switch(parameters: dict[str, Any], given: list[Any]) -> Sequence[Any]:
    branches = [lambda *arrays, branch=branch: _closed(branch, arrays) for branch in parameters["branches"]]
    return jax.lax.switch(given[0], branches, *given[1:])


def _while(parameters: dict[str, Any], given: list[Any]) -> Sequence[Any]:
    asked, done = parameters["cond_nconsts"], parameters["body_nconsts"]
    tests, bodies, first = given[:asked], given[asked : asked + done], given[asked + done :]
    return jax.lax.while_loop(
        lambda carry: _closed(parameters["cond_jaxpr"], [*tests, *carry])[0],
        lambda carry: _closed(parameters["body_jaxpr"], [*bodies, *carry]),
        first,
    )


def _scan(parameters: dict[str, Any], given: list[Any]) -> Sequence[Any]:
    fixed, carried = parameters["num_consts"], parameters["num_carry"]
    consts, first, each = given[:fixed], given[fixed : fixed + carried], given[fixed + carried :]

    def body(carry: list[Any], one: list[Any]) -> tuple[list[Any], list[Any]]:
        found = _closed(parameters["jaxpr"], [*consts, *carry, *one])
        return found[:carried], found[carried:]

    kept = {name: parameters[name] for name in ("length", "reverse", "unroll")}
    last, outputs = jax.lax.scan(body, first, each, **kept)
    return [*last, *outputs]


def _product(left: jax.Array, right: jax.Array, parameters: dict[str, Any]) -> jax.Array:
    """Returns what ``dot_general`` does: batches first, then what is left of one factor, then of the other."""
    (over_left, over_right), (of_left, of_right) = parameters["dimension_numbers"]
    left, rows = _sorted(left, of_left, over_left)
    right, columns = _sorted(right, of_right, over_right)
    batches = len(of_left)
    left = left.reshape(*left.shape[: batches + rows], *[1] * columns, left.shape[-1])
    right = right.reshape(*right.shape[:batches], *[1] * rows, *right.shape[batches:])
    terms = left * right
    if terms.shape[-1] > _LONGEST_SUM:
        return terms.sum(axis=-1)
    return sum((terms[..., k] for k in range(1, terms.shape[-1])), start=terms[..., 0])


def _sorted(array: jax.Array, batches: Sequence[int], summed: Sequence[int]) -> tuple[jax.Array, int]:
    """Returns a factor with batches first and what is summed over as its one last axis, and how many axes it keeps."""
    kept = [axis for axis in range(array.ndim) if axis not in {*batches, *summed}]
    array = jnp.transpose(array, (*batches, *kept, *summed))
    first = array.shape[: array.ndim - len(summed)]
    return array.reshape(*first, -1), len(kept)


def _cholesky(matrix: jax.Array, _: dict[str, Any]) -> jax.Array:
    """Returns the lower factor, column by column (Golub and Van Loan, Matrix Computations, section 4.2)."""
    size = matrix.shape[-1]
    zero = jnp.zeros_like(matrix[..., 0, 0])
    factor = [[zero] * size for _ in range(size)]
    for j in range(size):
        factor[j][j] = jnp.sqrt(matrix[..., j, j] - sum((factor[j][k] ** 2 for k in range(j)), start=zero))
        for i in range(j + 1, size):
            known = sum((factor[i][k] * factor[j][k] for k in range(j)), start=zero)
            factor[i][j] = (matrix[..., i, j] - known) / factor[j][j]
    return jnp.stack([jnp.stack(row, axis=-1) for row in factor], axis=-2)


def _triangular(matrix: jax.Array, right: jax.Array, parameters: dict[str, Any]) -> jax.Array:
    """Returns the solution of a triangular system, by substitution."""
    matrix = jnp.swapaxes(matrix, -1, -2) if parameters["transpose_a"] else matrix
    size, forward = matrix.shape[-1], parameters["lower"] != parameters["transpose_a"]
    rows: dict[int, jax.Array] = {}
    for i in range(size) if forward else range(size - 1, -1, -1):
        known = [matrix[..., i, k, None] * row for k, row in rows.items()]
        rows[i] = right[..., i, :] - sum(known[1:], start=known[0]) if known else right[..., i, :]
        if not parameters["unit_diagonal"]:
            rows[i] = rows[i] / matrix[..., i, i, None]
    return jnp.stack([rows[i] for i in range(size)], axis=-2)


_LOOPS: dict[str, Callable[[dict[str, Any], list[Any]], Sequence[Any]]] = {
    "cond": _switch,
    "while": _while,
    "scan": _scan,
}
_ALGEBRA: dict[str, Callable[..., jax.Array]] = {
    "dot_general": _product,
    "cholesky": _cholesky,
    "triangular_solve": _triangular,
}
