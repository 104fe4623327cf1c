// The glow table's bytes as part of the library: no file is needed at run time.
    .section .rodata
    .global lampglow_glow_table_begin
    .global lampglow_glow_table_end
    .balign 16
lampglow_glow_table_begin:
    .incbin LAMPGLOW_GLOW_TABLE
lampglow_glow_table_end:
    .byte 0
    .section .note.GNU-stack,"",%progbits
