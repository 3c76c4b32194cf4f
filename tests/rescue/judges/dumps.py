import sys,math,re
fn=sys.argv[1]; want=set(map(int,sys.argv[2:]))
n=-1;rows=[];P=None;P0=None
for l in open(fn):
    w=l.split(None,5)
    if not w: continue
    if w[0]=='P':
        P=tuple(map(float,l.split()[2:7]));P0=P0 or P
    elif w[0]=='E' and w[3]=='Log' and len(w)>4 and w[4] in('M','X','G'):
        if w[4]=='M': rows.append(w[5].strip().split(None,1))
        elif w[4]=='X':
            n+=1;x,y,h,g=map(float,w[5].split())
            # true relative
            dx,dy=P[1]-P0[1],P[2]-P0[2];c,s=math.cos(-P0[3]),math.sin(-P0[3])
            tx,ty,th=c*dx-s*dy,s*dx+c*dy,P[3]-P0[3]
            e=math.hypot(tx-x,ty-y);he=math.degrees((h-th+math.pi)%(2*math.pi)-math.pi)
            print('search',n,'t',w[2],'true %.2f %.2f (start frame %.2f %.2f) believed %.2f %.2f err %.2f head err %.0f given %d'%(P[1],P[2],tx,ty,x,y,e,he,g))
            if n in want:
                for r,t in rows: print(r,t)
            rows=[]
        elif w[4]=='G' : print('   G',w[2],w[5].strip(), 'at true %.2f %.2f'%(P[1],P[2]))
