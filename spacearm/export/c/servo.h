/* The servo: what it is told, what it keeps, what it remembers, what it says. SI units, radians;
 * the twist in axes of: $frame. shares[] is what each of these leaves of the motion: $causes.
 * halt is 0, or why the arm is brought to rest: $halts. */
$structs
extern const ${name}_servo_limits ${name}_servo_nominal; /* what it keeps unless told otherwise */

/* At rest at q; it searches before it moves. */
void ${name}_servo_begin(const double q[$N], ${name}_servo_memory *memory);

/* A step: tick->rates are the joint rates until the next. At most $operations operations. */
void ${name}_servo_step(const ${name}_servo_seen *seen, const ${name}_servo_limits *limits,
                        ${name}_servo_memory *memory, ${name}_servo_tick *tick);
