#include "$name.h"

#include <math.h>
