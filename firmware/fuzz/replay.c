/* SPDX-License-Identifier: Apache-2.0
 *
 * Runs the files that it is given through the fuzzer's test: to see again what it found, and which lines were reached.
 */
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#define LONGEST 65536

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size);

int main(int count, char **names)
{
    static uint8_t bytes[LONGEST];
    for (int i = 1; i < count; i++) {
        FILE *file = fopen(names[i], "rb");
        if (file == NULL) {
            perror(names[i]);
            return 1;
        }
        LLVMFuzzerTestOneInput(bytes, fread(bytes, 1, sizeof bytes, file));
        fclose(file);
    }
    return 0;
}
