
/* Numbers of the arm, SI units: body 0 is the spacecraft, joint i (from 0) carries body i + 1. */
typedef struct {
$fields
} ${name}_parameters;

extern const ${name}_parameters ${name}_nominal; /* the arm's own */
