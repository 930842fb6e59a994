/* $arm.
 * The spacecraft is $mode. Written by spacearm; SI units, radians, spacecraft axes. */
#ifndef ${NAME}_H
#define ${NAME}_H

#define ${NAME}_JOINTS $N
#define ${NAME}_ROWS $K

#ifdef __cplusplus
extern "C" {
#endif
$struct
$declarations
#ifdef __cplusplus
}
#endif
#endif
