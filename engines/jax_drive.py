

def parameters(**changed):
    """All parameters as an array; '.' in a name is written '__', as gear__f0=0.05."""
    given = {n.replace("__", "."): v for n, v in changed.items()}
    unknown = set(given) - set(PARAMETERS)
    if unknown:
        raise KeyError(f"no parameter '{sorted(unknown)[0]}'; there are {', '.join(PARAMETERS)}")
    return jnp.array([given.get(n, v) for n, v in PARAMETERS.items()])


def step_torque(phi, w, x, u, t, h, mobility, free, p):
    """Torque of the drive over one step of an engine, implicit in the speed at its end.

    The engine moves by v = free + h mobility tau, phi + h v. For one machine; jax.vmap takes many.

    phi, w: angles [rad] and speeds [rad/s] of the motors at the start, shape (n,)
    x, u, t, h: friction states, controls, time [s], step [s]
    mobility: acceleration of the motors' angles for a torque at them, shape (n, n); J inv(M) J', rotors included in M
    free: speeds at the end of the step without this torque, shape (n,)
    p: parameters()

    Returns tau [N.m], the friction states after the step, and v.
    """
    q, identity = prepare(p), jnp.eye(len(MOTORS))

    def correction(v, held):
        tau, slope = implicit(v, *held[:-2])
        by, alone = held[-2:]
        left = v - alone - by @ tau
        step = identity - by @ slope
        return (left / step[0] if len(MOTORS) == 1 else jnp.linalg.solve(step, left)), step

    def again(state):
        v, _, k = state
        change = correction(v, fixed)[0]
        share = jnp.where(k < PLAIN, 1.0, 0.5)  # half of it where whole ones go to and fro across a corner
        return v - share * change, jnp.max(jnp.abs(change) / (1 + jnp.abs(v))), k + 1

    given = (x, phi, w, u, t, h, q, h * mobility, free)
    fixed = jax.tree.map(jax.lax.stop_gradient, given)
    start = fixed[2] + 0.0 * fixed[-1]
    small = jnp.where(start.dtype == jnp.float64, 1e-7, 1e-5)
    begin = start, jnp.asarray(jnp.inf, start.dtype), 0
    v = jax.lax.while_loop(lambda s: (s[1] > small) & (s[2] < MOST), again, begin)[0]
    left, step = v - free - (h * mobility) @ implicit(v, *given[:-2])[0], correction(v, fixed)[1]
    step = jax.lax.stop_gradient(step)
    v = v - (left / step[0] if len(MOTORS) == 1 else jnp.linalg.solve(step, left))  # its derivatives are those of v
    tau, x_next = torque(phi + h * v, v, (v - w) / h, v, x, u, t + h, h, q)
    return tau, x_next, v
